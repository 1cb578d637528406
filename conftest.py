"""What holds for every test: a property is judged by its examples, not by how long one takes."""

from hypothesis import settings

settings.register_profile("patient", settings(), deadline=None)
settings.load_profile("patient")
