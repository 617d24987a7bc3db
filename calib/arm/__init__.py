"""Arms: from a URDF or MJCF to a serial chain, planar or spatial, and its vectorised kinematics.

In the order in which `loading.load_arm` goes through them:

- `robots`, `robot_text`: the bundled robots; a description's text, checked
- `urdf`, `mjcf`, `mjcf_text`, `description`: its tree of links and joints, of both formats
- `rotations`, `rigid`: rotation vectors, matrices and quaternions; rigid motions
- `posture`: where the links are at some joint values, and the chain of the active joints
- `finding`, `choice`: joints and tip by the furthest reach, or as a user names them
- `plane`: where a planar arm's tip moves
- `spatial_chain`, `gravity`: positions and Jacobians of a chain; how weights pull at its joints
- `arm`: `PlanarArm` and `SpatialArm`, with names, ranges and kinematics
"""
