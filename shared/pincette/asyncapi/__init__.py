"""The keys of the bus as an AsyncAPI document, made from their declarations."""
