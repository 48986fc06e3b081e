"""Messages that name the nearest of the names that exist."""

from surefoot.errors import unknown


def test_a_name_unlike_any_other_gets_the_list_alone():
    assert unknown("cat", "zzz", ["tom", "kit"]) == "there is no cat 'zzz'. Known: tom, kit"


def test_the_nearest_name_is_suggested():
    message = unknown("cat", "tomm", iter(["tom", "kit"]))
    assert message == "there is no cat 'tomm'; did you mean 'tom'? Known: tom, kit"
