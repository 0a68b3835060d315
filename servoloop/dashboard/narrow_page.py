"""Layout of the page on a phone: the arm is above the controls, and the stop button is always visible."""

from typing import Final

NARROW: Final = "36em"
"""Page width below which viser moves all panels to a sheet at the bottom of the page, over the arm."""
CONTROLS_SHARE: Final = "45%"
"""Maximum height of the controls, as a percentage of the page height."""
PINNED: Final = "<i class='servoloop-pinned'></i>"
"""Marker in front of a control that stays visible while the controls are scrolled."""
_SHEET: Final = ".mantine-Paper-root[style*='position: fixed']"
"""CSS selector of the sheet, which does not have a CSS class in viser."""
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
