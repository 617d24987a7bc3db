"""Arms: from a URDF to a serial chain, planar or spatial, and its vectorised kinematics."""
