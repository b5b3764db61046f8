"""Where a description's phrases come from: rules, a language model, and how well they do."""
