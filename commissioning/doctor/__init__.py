"""What ails an arm: measured, judged, and ranked by what is most likely the root of it."""
