"""Generate the MoveIt configuration of an arm from the arm's folder."""
