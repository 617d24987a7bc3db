"""Small log files, for the tests of reading logs."""

import pytest

from calib import LogError, read_log

GOOD = "a,b,x,y\n0.1,0.2,1,2\n0.2,0.4,3,4\n0.3,0.1,5,6\n"


def refused(path, message, error=LogError, **options):
    with pytest.raises(error, match=message) as caught:
        read_log(path, **({"joints": ["a", "b"]} | options))
    assert "\n" not in str(caught.value)
