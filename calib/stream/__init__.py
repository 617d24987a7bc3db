"""What follows a stream of samples: the maps of the paper."""
