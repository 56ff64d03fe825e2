"""MJCF, grey-box model and log compared; estimators compared."""
