"""The window: its frame, header, footer, keys and dialogs."""
