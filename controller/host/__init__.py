"""Follow the joint commands of another controller manager, which runs in another program."""
