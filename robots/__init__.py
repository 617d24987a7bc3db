"""The bundled robots: plain URDF files, listed by `calib robots`."""
