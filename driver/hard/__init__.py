"""Hard cases: solved and checked against independent answers, or refused for a stated reason.

`case` says what a case is and runs it as a user would, `checks` compares with answers that owe
nothing to the solver, `suite` runs all and reports; the cases themselves are data,
the list CASES in the module of their family (suite.FAMILIES). Those of the family `random` are
drawn from seeds: `generator` writes scenes from what `composition` and `shapes` make of the `dice`,
`random` runs and judges them by `laws`, `judgement`, `sensitivity`, `refusal` and `states`.
"""
