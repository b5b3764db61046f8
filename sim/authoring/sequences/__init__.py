"""Home sequences: their generation on homes with words, and the checks that generator and `validate` share."""
