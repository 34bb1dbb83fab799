"""Vehicles of a user's own, each in a file: `vehicle=custom vehicle.target=experiments.vehicles.unicycle.Unicycle`."""
