"""What moves and what is measured: models, systems, steps, paths from inputs."""
