"""Pure functions as C with the same bits: their types, their translation, and the texts of programs."""
