"""Maps: lattices of nodes that learn the motor and the sensory space."""
