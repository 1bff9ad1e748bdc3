"""The interactive viewer: a model without a window (state, actions, engine), and a window around it."""
