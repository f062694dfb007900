//! What a user reads is about the machine, its sensors and its logs.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wheelstate_identify::log::Log;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicle::Vehicle;
use wheelstate_identify::vehicles::{nursing_robot, wheel_loader, wheelchair, wheeled_robot};

/// Words of optimisers and of their ways to end, and numbers that are none.
const WORDS: [&str; 13] = [
    "solver",
    "conic",
    "clarabel",
    "kkt",
    "feasib",
    "solved",
    "insufficient",
    "iteration",
    "jacobian",
    "newton",
    "cholesky",
    "nan",
    "inf",
];

/// The words of a message, in small letters.
fn words(message: &str) -> impl Iterator<Item = String> {
    message.split(|c: char| !c.is_alphabetic()).map(str::to_lowercase).filter(|word| !word.is_empty())
}

/// All that a fit says, or why it refuses.
fn said(vehicle: &Vehicle, log: &Log) -> Vec<String> {
    match vehicle.fit(std::slice::from_ref(log), &FitRequest::default(), &Progress::none()) {
        Ok(report) => report.warnings.into_iter().chain(report.notes).collect(),
        Err(error) => vec![error.to_string()],
    }
}

/// A log as good as it comes, its first seconds, one with a channel that stands still, one with a channel that is nothing but
/// noise, one with opposite signs.
fn spoilt(log: &Log, rng: &mut ChaCha8Rng) -> Vec<(String, Log)> {
    let mut all = vec![("whole".to_owned(), log.clone())];
    let few = ((3.0 / log.period()) as usize).min(log.len());
    all.push(("first 3 s".to_owned(), log.slice(0..few, |_| true)));
    for index in (0..log.channels.len()).filter(|index| !log.channels[*index].name.starts_with("true_")) {
        let mut change = |what: &str, of: &mut dyn FnMut(f64) -> f64| {
            let mut log = log.clone();
            log.channels[index].values.iter_mut().for_each(|value| *value = of(*value));
            all.push((format!("{} {what}", log.channels[index].name), log));
        };
        change("still", &mut |_| 0.0);
        change("noise", &mut |_| rng.random::<f64>() - 0.5);
        change("opposite", &mut |value| -value);
    }
    all
}

#[test]
fn no_message_to_a_user_has_a_word_of_an_optimiser() {
    let mut wrong = Vec::new();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for (vehicle, scenario) in [
        (&wheelchair::VEHICLE, "climb"),
        (&wheel_loader::VEHICLE, "accelerate-brake"),
        (&nursing_robot::VEHICLE, "coughs"),
        (&wheeled_robot::VEHICLE, "sine"),
    ] {
        let request = Request { scenario: scenario.to_owned(), seed: 3, ..Request::default() };
        let log = vehicle.simulate(&request).unwrap();
        for (what, log) in spoilt(&log, &mut rng) {
            for message in said(vehicle, &log) {
                let is = |word: &str, other: &str| if word.len() > 3 { other.contains(word) } else { other == word };
                let found = WORDS.iter().find(|word| words(&message).any(|other| is(word, &other)));
                if let Some(word) = found {
                    wrong.push(format!("{} {scenario}, {what}: \"{word}\" in {message}", vehicle.name));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
