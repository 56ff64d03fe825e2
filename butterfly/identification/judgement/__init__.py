"""How far to trust an estimate: covariance, intervals, identifiability, findings, validation."""
