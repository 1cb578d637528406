"""Answers of services that are given later."""

import pytest

from husky_runtime.nodes.service_desk import Deferred


@pytest.mark.parametrize("early", [True, False])
def test_an_answer_is_sent_once_whenever_it_is_complete(early):
    sent = []
    answer = Deferred({"ticks": 0})
    if early:
        answer.complete()
    answer.when_complete(sent.append)
    assert len(sent) == early
    answer.response["ticks"] = 5
    answer.complete()
    answer.complete()
    assert sent == [{"ticks": 5}]
