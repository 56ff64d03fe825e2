"""What only reproduces the thesis: its method, formulas, tables and figures, slips included."""
