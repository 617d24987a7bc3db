"""Training: from samples to a model, and the model's errors.

In the order of a training, whose steps `train.train` goes through:

- `settings`, `options`: numbers that were chosen; what a user asks for
- `preparation`: a log of each sensor as it is learned from
- `fitted_log`: its rows with the body that was fitted to them
- `bodies`: what a body begins from, one fit for all sensors
- `wrong_rows`, `late_clock`: rows that contradict the others; a delay along a path
- `socket_fit`, `socket_places`: an arm and the sockets that it touched
- `maps`: both maps and their links
- `residuals`, `bounds`: errors of rows that were not learned, and what bounds them
"""
