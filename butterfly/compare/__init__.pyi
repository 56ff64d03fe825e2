from .leaderboard import Entry as Entry
from .three_way import ThreeWay as ThreeWay
from .three_way import compare_three as compare_three
