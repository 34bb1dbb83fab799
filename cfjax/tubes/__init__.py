"""Certified tubes along a path: which of them holds where, proven while the path is read."""

from cfjax.check.reference import CertifiedTube
from cfjax.tubes.follow import Following, Link, Stretch, follow


__all__ = ["CertifiedTube", "Following", "Link", "Stretch", "follow"]
