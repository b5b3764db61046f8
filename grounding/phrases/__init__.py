"""Where phrases "X owns Y in Z" come from: the dataset, rules, or a language model."""
