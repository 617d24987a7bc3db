"""Apply: what a calibrated model gives to a controller or to another program."""
