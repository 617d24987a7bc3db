"""What follows a stream of samples: the monitor, and the maps of the paper."""
