"""The commands as the user calls them: options in, text or JSON out."""
