"""Output of single commands: tables, plots and dialogs."""
