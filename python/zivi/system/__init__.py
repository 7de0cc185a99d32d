"""What moves: one mass or a mechanism, its forces, its wall or its gaps."""

from zivi.system.mass import Force, ImpactSystem, LinearForce

__all__ = ["Force", "ImpactSystem", "LinearForce"]
