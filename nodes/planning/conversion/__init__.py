"""Parts of MoveIt's messages as objects of planning/, and back. No function here communicates."""
