"""MJCF, grey-box model and log side by side; estimators side by side."""
