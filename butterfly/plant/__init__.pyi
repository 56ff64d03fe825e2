from .bench import Bench as Bench
from .joints import GreyBoxJoint as GreyBoxJoint
from .joints import MujocoJoint as MujocoJoint
from .joints import Simulator as Simulator
from .motor import CommandPath as CommandPath
from .motor import Motor as Motor
from .motor import SimulatedMotor as SimulatedMotor
from .robot import Robot as Robot
from .rollout import simulate_runs as simulate_runs
from .sensors import Clock as Clock
from .sensors import Encoder as Encoder
from .setup import Setup as Setup

def has_display() -> bool: ...
