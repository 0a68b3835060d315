"""Plan motions of an arm around obstacles, from its arm folder."""

from servoloop.extras import require_extras

require_extras("motion planning", "planning")
