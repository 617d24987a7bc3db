"""Maps: lattices of nodes that learn the motor and the sensory space.

In the order of a training, each file after those that it needs:

- `settings`: every number that was chosen, with its reason
- `lattice`, `map`: how nodes are joined; nodes in a space, the nearest ones, their errors
- `density`, `rates`: gains of a varying density (eq. 7, 8); learning rates (eq. 4, 10, 12)
- `batch`, `vdsom`, `dsom`, `gng`: the rules that train: all samples at once, or one at a time
- `links`, `clusters`: Hebbian links of two maps (eq. 5, 6); the branches they hold
- `linear_models`, `association`: both maps and their links, read out in both directions
- `som`: `SOM`, which trains any of these
- `blend`, `local_models`, `predictor`: what a smooth part leaves over, by the nodes around a point
- `model_selection`, `node_bounds`: which nodes carry local models; the bound around each node
"""
