"""Robot models: robot files, URDFs, kinematics and meshes of arm and gripper."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
