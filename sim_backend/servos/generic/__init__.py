"""Control loop, table and instructions of servos other than STS. They follow the manuals as far as those go."""
