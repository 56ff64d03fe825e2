"""The identified joint as a file for another program, and how far it moves as ours does."""
