"""Classic lighting of surfaces and its baking into textures."""
