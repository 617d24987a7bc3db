"""Change: whether a model still fits its arm, what changed, and the model that follows.

In the order of `judge`, each file after those that it needs::

    causes        what may have changed, by how much, in which words
    frame         the old belief in the frame of the log
    rows          those of a log that count, and that do not contradict all others
    system        these against a belief, linear in all that may have changed
    noise         its size, that of one encoder, a joint's play, and waves of joints
    significance  which group of parameters explains more than chance, and how the bound holds
    steps         which cause explains more than chance from a row on
    explanation   a set of causes, fitted to the log, and the posterior under it
    explain       the search for the sets of causes of greatest evidence, each fitted to the log
    evidence      tests, bound, explanations and orientations weighed together
    update        the posterior and the belief that follow, judged by rows that are held out
    words         causes and notes in sentences
    verdict       what users see of all this
    judge         all of these in turn; `check`
    adaptation    a model with its facts and history round another belief
    adapt         a model and a log in, a re-calibrated model out
"""
