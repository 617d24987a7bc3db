"""Change: whether a model still fits its arm, what changed, and the model that follows.

In the order of `judge`, each file after those that it needs::

    settings      tuned numbers of several files
    rows          the rows of a log that count, beside the model's predictions
    causes        what may have changed, by how much, in which words
    frame         the old belief in the frame of the log
    observations  the rows that do not contradict all others
    system        these beside a belief, linear in all that may have changed
    significance  the noise, and which group of parameters explains more than chance
    play          a joint that has more play than the model knows
    explanation   a set of causes fitted to the log, and the climb to the best fit
    explain       the search for the sets of greatest evidence
    tool          how the tool is turned, by orientations
    evidence      tests, bound and explanations weighed together
    update        the belief that follows, judged by rows that are held out
    words         causes and notes in sentences
    verdict       what users see of all this
    judge         all of these in turn; `check`
    adaptation    a model with its facts and history round another belief
    adapt         a model and a log in, a re-calibrated model out
"""
