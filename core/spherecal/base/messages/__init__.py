"""What the engine says, in the languages it knows: one table for each, resources/messages/LANGUAGE.toml."""
