//! Chooses the format of a dataset and reads it.

use std::path::Path;

use super::error::Error;
use super::model::{Format, Model};
use super::{Warning, colmap, nerfstudio, opensfm};

impl Format {
    /// Whether a folder has this layout.
    pub(super) fn is_in(self, dataset: &Path) -> bool {
        match self {
            Self::Colmap => colmap::is_in(dataset),
            Self::Nerfstudio => nerfstudio::is_in(dataset),
            Self::Opensfm => opensfm::file(dataset).is_some(),
        }
    }

    /// Whether a folder has files of this format in an unusual place, which matters only where no format is in its
    /// usual place.
    pub(super) fn is_elsewhere(self, dataset: &Path) -> bool {
        self == Self::Colmap && colmap::is_elsewhere(dataset)
    }
}

impl Model {
    /// Reads a dataset in the format `asked`, else in the first one whose files exist. Records that cannot be used are
    /// left out, or are an error where `strict` is set.
    pub(super) fn read(dataset: &Path, asked: Option<Format>, strict: bool) -> Result<Self, Error> {
        let found: Vec<Format> = Format::ALL.into_iter().filter(|format| format.is_in(dataset)).collect();
        let format = match asked {
            Some(format) if found.contains(&format) || format.is_elsewhere(dataset) => format,
            Some(format) => {
                let looked_for = format.looked_for().to_owned();
                return Err(Error::no_model(dataset, looked_for, asked));
            }
            None => {
                let none = || Error::no_model(dataset, Format::ALL.map(Format::looked_for).join(", "), None);
                let elsewhere = || Format::ALL.into_iter().find(|format| format.is_elsewhere(dataset));
                found.first().copied().or_else(elsewhere).ok_or_else(none)?
            }
        };
        let mut model = match format {
            Format::Colmap => colmap::read(dataset, strict)?,
            Format::Nerfstudio => nerfstudio::read(dataset, strict)?,
            Format::Opensfm => opensfm::read(dataset, strict)?,
        };
        let mut others: Vec<Format> = found.into_iter().filter(|other| *other != format).collect();
        if format != Format::Colmap && others.is_empty() && colmap::is_unusual(dataset) {
            others.push(Format::Colmap);
        }
        if asked.is_none() && !others.is_empty() {
            model.warnings.push(Warning::SeveralFormats { used: format, others });
        }
        Ok(model)
    }
}
