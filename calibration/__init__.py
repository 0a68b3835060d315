"""Tools for calibrating single servos. The control cycle does not use them."""
