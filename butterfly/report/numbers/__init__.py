"""What results say as numbers: the same from Python, beside a report and by ``--json``."""
