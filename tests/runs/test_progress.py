"""The bar of a training shows its epochs and its losses."""

from surefoot.runs.progress import epochs_bar


def test_a_bar_counts_the_epochs_of_a_training_and_shows_its_losses(capsys):
    with epochs_bar("fit") as progress:
        for epoch in (1, 2, 3):
            progress(epoch, 3, 0.25, 0.5)
    shown = capsys.readouterr().err
    assert "fit:" in shown
    assert "/3 [" in shown
    assert "train=0.2500, validation=0.5000" in shown


def test_epochs_of_a_checkpoint_count_but_took_no_time(capsys):
    with epochs_bar("fit") as progress:
        progress(9, 10, 0.25, 0.5)
        progress(10, 10, 0.25, 0.5)
    shown = capsys.readouterr().err
    assert "10/10 [" in shown
    assert "1/10 [" not in shown


def test_no_loss_of_frames_held_out_is_shown_without_any(capsys):
    with epochs_bar("fit") as progress:
        progress(1, 1, 0.25, float("nan"))
    shown = capsys.readouterr().err
    assert "train=0.2500]" in shown
    assert "nan" not in shown
