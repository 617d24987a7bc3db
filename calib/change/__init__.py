"""Change: whether a model still fits its arm, what changed, and the model that follows.

In the order of `judge`, each file after those that it needs::

    causes        what may have changed, by how much, and how it is worded
    frame         the old belief in the frame of the log
    rows          the rows of a log that count, with a model's predictions
    system        the rows against a belief, linear in all that may have changed
    noise         size of the noise, noise of one encoder, play and waves of joints
    significance  tests of groups of parameters, and of the model's own bound
    steps         a change within the log
    explanation   a set of causes, fitted to the log, and the posterior under it
    explain       the search for the sets of causes of greatest evidence
    evidence      tests, bound, explanations and orientations weighed together
    update        the belief that follows, judged by held-out rows
    words         causes and notes in sentences
    verdict       the result for users
    judge         all of these in turn; `check`
    adaptation    a model around another belief, with its facts and history
    adapt         a model and a log in, a re-calibrated model out
"""
