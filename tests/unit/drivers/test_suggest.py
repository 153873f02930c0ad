from drivers.schema.suggest import did_you_mean


def test_a_letter_that_looks_like_a_digit_is_the_digit():
    assert did_you_mean("KO", ["K0", "K1", "K2"]) == "; did you mean 'K0'?"
    assert did_you_mean("Kl", ["K0", "K1", "K2"]) == "; did you mean 'K1'?"
    assert did_you_mean("k2", ["K0", "K1", "K2"]) == "; did you mean 'K2'?"
