"""Training: from samples to a model, and the model's errors.

In the order of a training, whose steps `train.train` goes through:

- `settings`, `options`: numbers that were chosen; a user's options
- `preparation`: the log of each sensor, made ready for learning
- `fitted_log`: its rows with the body that was fitted to them
- `bodies`: the template of a body, one fit for all sensors
- `wrong_rows`, `late_clock`: rows that contradict the others; a delay along a path
- `socket_fit`, `socket_places`: an arm and the sockets that it touched
- `maps`: both maps and their links
- `residuals`, `bounds`: errors of rows that were not learned, and what bounds them
"""
