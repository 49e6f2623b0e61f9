"""The commands, as the user calls them: options in, words or JSON out. What they do lies elsewhere."""
