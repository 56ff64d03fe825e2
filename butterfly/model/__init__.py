"""What the robot is: its parameters with units, and the equations they enter."""
