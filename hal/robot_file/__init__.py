"""The robot file and the calibration file beside it: which servo drives which joint."""
