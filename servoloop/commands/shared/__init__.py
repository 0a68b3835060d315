"""Parts that several commands share: options, tables, questions, and the client of the planner."""
