# for other rooms
from .calibration import (
    CalibrationRequest as CalibrationRequest,
    calibrate as calibrate,
    parse_place as parse_place,
)
from .external_test import test_external_robot as test_external_robot
from .plan_trial import (
    PlanAnswer as PlanAnswer,
    PlanQuery as PlanQuery,
    PlanRefusal as PlanRefusal,
    plan_figures as plan_figures,
    plan_in_scene as plan_in_scene,
    plan_picture as plan_picture,
)
from .proposal import ProposalRequest as ProposalRequest, propose as propose
from .robot_test import RobotTestResult as RobotTestResult, test_robot as test_robot
from .summary import summary_of as summary_of, summary_of_new as summary_of_new
from .target_syntax import quantity as quantity
