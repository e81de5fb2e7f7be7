"""Actions suspended while a capture moves their objects."""

import bpy


class SuspendedActions:
    """Suspends actions and restores them. Only names are kept, no Blender data."""

    def __init__(self) -> None:
        self._held: dict[str, str] = {}

    def take(self, target: bpy.types.Object) -> None:
        """Take an object's action off, if it has one; it is kept in the file."""
        animation = target.animation_data
        if animation is not None and animation.action is not None:
            self._held[target.name] = animation.action.name
            animation.action.use_fake_user = True
            animation.action = None

    def give_back(self) -> None:
        """Give all objects that are still there their actions back."""
        for name, action_name in self._held.items():
            target, action = bpy.data.objects.get(name), bpy.data.actions.get(action_name)
            if target is not None and target.animation_data is not None and action is not None:
                target.animation_data.action = action
        self._held.clear()
