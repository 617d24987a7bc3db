"""What every refusal has in common: an error of its kind, in one line, with words that help."""

import pytest


def refused(error, words, call, *values, **options):
    """Call, and return the error: of this kind, in one line that a pattern finds words in."""
    with pytest.raises(error, match=words) as caught:
        call(*values, **options)
    assert "\n" not in str(caught.value)
    return caught.value
