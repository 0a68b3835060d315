"""``servoloop demo``: the main job from the action to the bytes, shown and measured."""
