"""Use: what a model gives to a controller, a plan or another program."""
