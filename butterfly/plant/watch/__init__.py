"""Watch the robot: MuJoCo's window, a browser, pictures and films."""
