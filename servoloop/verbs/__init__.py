"""The verbs of the command line, one module each; what they do stands below ``servoloop``, as functions for scripts."""
