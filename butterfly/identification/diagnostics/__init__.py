"""Whether an estimate can be trusted: residuals, unit errors, physics; each returns findings."""
