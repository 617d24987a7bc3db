"""Run the command line as `python -m calib_cli`."""

from . import main

main()
