"""Plans a gait cycle on a slope and draws it: python scripts/plan_incline.py [DEGREES] [body_z]."""

import math
import sys

from husky_bringup.front import end_by_signals, end_if_asked

end_by_signals()

# What follows takes a second to import.
from husky_control.planning.collocation.planner import default_planner  # noqa: E402
from husky_control.planning.collocation.request import PlanRequest  # noqa: E402
from husky_description.robot import load_robot  # noqa: E402
from husky_experiments.figures.plan import draw_plan  # noqa: E402

degrees = float(sys.argv[1]) if len(sys.argv) > 1 else 45.0
mode = sys.argv[2] if len(sys.argv) > 2 else "vector"
request = PlanRequest(math.radians(degrees), speed=0.3, thrust_mode=mode, gait="climb")
plan = default_planner(load_robot()).plan(request)
end_if_asked()
plan.save("plan.npz")
print(f"thrust {plan.thrust.mean(axis=0).round(1)} N in the slope frame, {plan.mesh_error}")
print(f"plan.npz and {draw_plan(plan, 'plan.png')} written")
