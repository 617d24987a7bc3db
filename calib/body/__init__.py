"""The body: what an arm and its sensor must obey, as one Gaussian belief over its parameters.

`body_fit.fit` finds it from rows; `belief.Body` answers: positions, slopes, bounds, words.
"""
