"""Pure array functions: rigid transforms, the camera model, planes, 2D segments."""
