"""Preview: the arm and its learned maps as a page of meshcat's viewer."""
