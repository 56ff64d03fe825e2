"""What was recorded: logs, how to read and write them, and whether they can be trusted."""
