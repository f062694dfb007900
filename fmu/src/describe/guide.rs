//! What a person wrote about a machine, for its documentation page. The build script finds it by the machine's name:
//! the page of its module in the estimators, the pages that this one links to, and its lines in the README.

use crate::model::Model;

/// The text about one machine, as HTML.
#[derive(Debug)]
pub struct Guide {
    /// The folder of its estimator.
    machine: &'static str,
    /// Headings, as plain text, with what stands under them; the first one has an empty heading.
    pub sections: &'static [(&'static str, &'static str)],
    /// Pages of models and filters that the sections link to: first sentence, as plain text, and the whole.
    pub linked: &'static [(&'static str, &'static str)],
    /// What was measured: what, and how much with the test that shows it.
    pub measured: &'static [[&'static str; 2]],
    /// What the estimator cannot do.
    pub limits: &'static [&'static str],
}

impl Guide {
    /// What stands before the first heading.
    pub fn introduction(&self) -> String {
        self.sections.iter().take_while(|(title, _)| title.is_empty()).map(|(_, text)| *text).collect()
    }
}

const GUIDES: &[Guide] = include!(concat!(env!("OUT_DIR"), "/guides.rs"));

/// The guide to a model; one from outside this repository has none.
pub fn of(model: &Model) -> Option<&'static Guide> {
    let folder = model.command_name().replace('-', "_");
    GUIDES.iter().find(|guide| guide.machine == folder)
}
