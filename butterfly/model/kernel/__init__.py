"""The compiled kernel; `butterfly.model.greybox` says what it means and what is differentiated."""
