"""Code that several commands share: options, tables and questions."""
