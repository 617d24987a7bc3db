"""calib: sensorimotor calibration of robot arms."""
