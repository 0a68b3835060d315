"""The passport of a line: every servo's EEPROM in a readable file, compared and written back."""
