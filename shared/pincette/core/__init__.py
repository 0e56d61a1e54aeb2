"""Code that all programs share: services as data, topics, messages and their codec, plug-ins."""
