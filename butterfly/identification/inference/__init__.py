"""From equations to an estimate: covariance, intervals, identifiability, choice of terms."""
