"""Programs to copy and change: see README.md beside this file."""
