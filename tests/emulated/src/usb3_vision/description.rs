//! The GenICam description of the camera (GenApi schema 1.1), made from the table of features.

use std::fmt::Write;

use super::features::{Access, FEATURES, Feature, Kind, Limit};
use super::memory::{address_of, register_bytes};

/// The whole XML file. The exposure time has steps of `exposure_step_us`, where there are such.
pub(super) fn xml(vendor: &str, model: &str, exposure_step_us: Option<f64>) -> String {
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <RegisterDescription ModelName=\"{model}\" VendorName=\"{vendor}\" ToolTip=\"emulated\" StandardNameSpace=\"None\" \
         SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" MajorVersion=\"1\" MinorVersion=\"0\" \
         SubMinorVersion=\"0\" ProductGuid=\"00000000-0000-0000-0000-000000000001\" \
         VersionGuid=\"00000000-0000-0000-0000-000000000002\" xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">\n\
         <Category Name=\"Root\">"
    );
    for feature in FEATURES {
        let _ = write!(xml, "<pFeature>{}</pFeature>", feature.name);
    }
    xml += "</Category>\n";
    for feature in FEATURES {
        let step = exposure_step_us.filter(|_| feature.name == "ExposureTime");
        write_feature(&mut xml, feature, step);
    }
    xml + "<Port Name=\"Device\"/>\n</RegisterDescription>\n"
}

fn write_feature(xml: &mut String, feature: &Feature, step: Option<f64>) {
    let name = feature.name;
    let value = format!("<pValue>{name}Register</pValue>");
    let _ = match feature.kind {
        Kind::Integer(min, max, step) => {
            let max = match max {
                Limit::Fixed(max) => format!("<Max>{max}</Max>"),
                Limit::Feature(max) => format!("<pMax>{max}</pMax>"),
            };
            writeln!(xml, "<Integer Name=\"{name}\">{value}<Min>{min}</Min>{max}<Inc>{step}</Inc></Integer>")
        }
        Kind::Float(min, max, unit) => {
            let step = step.map(|step| format!("<Inc>{step}</Inc>")).unwrap_or_default();
            writeln!(
                xml,
                "<Float Name=\"{name}\">{value}<Min>{min}</Min><Max>{max}</Max>{step}<Unit>{unit}</Unit></Float>"
            )
        }
        Kind::Enumeration(entries) => {
            let entries: String = entries
                .iter()
                .map(|(entry, number)| {
                    format!("<EnumEntry Name=\"{entry}\"><Value>{number}</Value></EnumEntry>")
                })
                .collect();
            writeln!(xml, "<Enumeration Name=\"{name}\">{entries}{value}</Enumeration>")
        }
        Kind::Boolean => {
            writeln!(
                xml,
                "<Boolean Name=\"{name}\">{value}<OnValue>1</OnValue><OffValue>0</OffValue></Boolean>"
            )
        }
        Kind::Command => {
            writeln!(xml, "<Command Name=\"{name}\">{value}<CommandValue>1</CommandValue></Command>")
        }
        Kind::Text => writeln!(xml, "<StringReg Name=\"{name}\">{}</StringReg>", register(feature)),
    };
    let _ = match feature.kind {
        Kind::Text => Ok(()),
        Kind::Float(..) => writeln!(
            xml,
            "<FloatReg Name=\"{name}Register\">{}<Endianess>LittleEndian</Endianess></FloatReg>",
            register(feature)
        ),
        _ => writeln!(
            xml,
            "<IntReg Name=\"{name}Register\">{}<Sign>Signed</Sign><Endianess>LittleEndian</Endianess></IntReg>",
            register(feature)
        ),
    };
}

fn register(feature: &Feature) -> String {
    let access = if feature.access == Access::Read { "RO" } else { "RW" };
    format!(
        "<Address>{:#x}</Address><Length>{}</Length><AccessMode>{access}</AccessMode><pPort>Device</pPort>\
         <Cachable>NoCache</Cachable>",
        address_of(feature.name),
        register_bytes(feature.kind)
    )
}
