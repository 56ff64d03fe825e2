"""From frequency responses or logs to parameters, and how far to trust them."""
