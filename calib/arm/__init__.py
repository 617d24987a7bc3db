"""Arms: planar chains of joints, from a URDF to vectorised kinematics."""
