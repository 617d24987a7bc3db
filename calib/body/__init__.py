"""The body: what an arm and its sensor must obey, as one Gaussian belief over its parameters.

In the order of a fit, whose steps `body_fit.fit` goes through:

- `settings`: every number that was chosen, with its reason
- `parameters`, `curves`: named blocks with their priors; error curves of joints
- `views`, `sensors`: kinds of readings, how a sensor is placed
- `layout`, `loads`, `structure`: the parameters of a chain and its sensors; loads that bend its
  joints; predictions and derivatives
- `spatial`, `planar`, `drawing`: structures of both kinds of arms; a planar arm's drawing
- `covariance`: factors, roots and radii of Gaussians
- `rows`, `fit`: rows of sensors, one maximisation of a posterior
- `starts`: the best parameters to begin with
- `planar_starts`, `frame_starts`, `chain_starts`: signs, the sensor's frame, the whole chain
- `held_out`, `gate`: errors of rows predicted from others; the member that the rows support
- `body_fit`: from rows to a body with its bound
- `touch`: the same fit of touches of sockets
- `belief`: `Body`, which answers: positions, slopes, bounds, parameters with intervals
- `words`, `sensor_pose`, `row_notes`: the body and its sensor in words; what rows cannot determine
- `approach`, `information`: backlash; the most informative poses
"""
