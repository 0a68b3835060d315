"""The layout of the page on a phone: the arm above the controls, and the button that stops it always in sight."""

from typing import Final

NARROW: Final = "36em"
"""Below this width viser puts all panels into a sheet at the bottom of the page, over the arm."""
CONTROLS_SHARE: Final = "45%"
"""Maximum share of the page's height that the controls take."""
PINNED: Final = "<i class='servoloop-pinned'></i>"
"""The control that follows this HTML stays in sight while the controls are scrolled."""
_SHEET: Final = ".mantine-Paper-root[style*='position: fixed']"
"""The sheet; viser gives it no name."""
LAYOUT: Final = f"""<style>@media (max-width: {NARROW}) {{
  div:has(> {_SHEET}) {{ flex-direction: column }}
  div:has(+ {_SHEET}) {{ flex: 1 1 0; height: auto !important; min-height: 0 }}
  {_SHEET} {{
    position: static !important; flex: none !important; width: 100% !important;
    max-height: {CONTROLS_SHARE} !important;
  }}
  {_SHEET} .mantine-ScrollArea-content > div {{ width: 100% !important }}
  {_SHEET} .mantine-ScrollArea-content div:has(.servoloop-pinned) {{ overflow: visible !important }}
  {_SHEET} div:has(.servoloop-pinned) + div:has(> .mantine-Button-root) {{
    position: sticky; top: 0; z-index: 5
  }}
}}</style>"""
