"""Follow the joint commands of a controller manager that runs in another program."""
