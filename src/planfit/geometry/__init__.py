"""Pure array functions: rigid transforms, the camera model, 2D segments."""
