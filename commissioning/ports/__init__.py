"""Serial adapters: which there are, who may open them, what stands in their way."""
