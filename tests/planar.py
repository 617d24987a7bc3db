"""Closed forms of planar arms with two and three links, and URDFs of chains."""


def chain_urdf(joints: int, reach: float = 0.6, half: float = 1.4, slide: int | None = None) -> str:
    """Return the URDF of a planar chain of equal links; one joint may slide."""
    length = reach / joints
    parts = [f'<robot name="planar_{joints}r"><link name="base"/>']
    for k in range(joints):
        kind, axis, lower, upper = "revolute", "0 0 1", -half, half
        if k == slide:
            kind, axis, lower, upper = "prismatic", "1 0 0", 0.0, 0.1
        parent, x = (f"link_{k}", length) if k else ("base", 0.0)
        parts.append(
            f'<link name="link_{k + 1}"/><joint name="joint_{k + 1}" type="{kind}">'
            f'<parent link="{parent}"/><child link="link_{k + 1}"/><origin xyz="{x} 0 0"/>'
            f'<axis xyz="{axis}"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
        )
    parts.append(
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="link_{joints}"/>'
        f'<child link="tip"/><origin xyz="{length} 0 0"/></joint></robot>'
    )
    return "".join(parts)
