"""Characters to look at: films and pictures of clips and runs, drawn without a window."""
