"""What can be driven: the MuJoCo robot, its excitations, its clock and its encoder."""
