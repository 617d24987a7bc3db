"""The body: what an arm and its sensor must obey, as one Gaussian belief over its parameters."""
