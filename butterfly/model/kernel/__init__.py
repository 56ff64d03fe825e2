"""The compiled kernel; see `butterfly.model.greybox` for its meaning and derivatives."""
