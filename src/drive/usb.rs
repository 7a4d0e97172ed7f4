//! Serial devices by the serial number of their USB device: their names change when they come back. The tests have a folder
//! that looks like /sys, and no USB device that is pulled and put back.

use std::path::{Path, PathBuf};

use super::LinkError;

/// The device file of the USB serial port with this serial number.
pub(super) fn find(serial: &str) -> Result<PathBuf, LinkError> {
    find_under(Path::new("/sys/class/tty"), serial).map(|name| Path::new("/dev").join(name))
}

/// The name of the port; `ports` holds one folder for each (sysfs(5)), and the USB device that has the serial number is
/// one of the folders above its `device`.
fn find_under(ports: &Path, serial: &str) -> Result<String, LinkError> {
    let failed = |reason: String| LinkError::Open { path: format!("usb:{serial}"), reason };
    let listed = std::fs::read_dir(ports).map_err(|error| failed(format!("{}: {error}", ports.display())))?;
    let (mut found, mut others) = (Vec::new(), Vec::new());
    for port in listed.flatten() {
        let Ok(device) = port.path().join("device").canonicalize() else { continue };
        // only a USB device has both
        let usb = device.ancestors().take(5).find(|folder| folder.join("idVendor").exists());
        let theirs = usb.and_then(|folder| std::fs::read_to_string(folder.join("serial")).ok());
        let name = port.file_name().to_string_lossy().into_owned();
        match theirs.as_deref().map(str::trim) {
            Some(theirs) if theirs == serial => found.push(name),
            Some(theirs) => others.push(format!("{theirs} ({name})")),
            None => {}
        }
    }
    others.sort();
    match found.as_slice() {
        [name] => Ok(name.clone()),
        [] if others.is_empty() => Err(failed("no USB serial port is plugged in".into())),
        [] => {
            Err(failed(format!("no USB serial port has this serial number; there are {}", others.join(", "))))
        }
        names => {
            Err(failed(format!("several ports of this device: give one of {} by its path", names.join(", "))))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{create_dir_all, remove_file, write};
    use std::os::unix::fs::symlink;

    use super::*;

    /// A tree as sysfs has it: an FTDI adapter with its port two folders down, and a modem.
    #[test]
    fn ports_are_found_by_serial_number_under_any_name() {
        let folder = tempfile::tempdir().unwrap();
        let (ports, devices) = (folder.path().join("class"), folder.path().join("devices"));
        let plug = |usb: &str, serial: &str, name: &str| {
            let device = devices.join(usb).join(format!("{usb}:1.0")).join(name);
            create_dir_all(&device).unwrap();
            write(devices.join(usb).join("idVendor"), "0403\n").unwrap();
            write(devices.join(usb).join("serial"), format!("{serial}\n")).unwrap();
            create_dir_all(ports.join(name)).unwrap();
            symlink(device, ports.join(name).join("device")).unwrap();
        };
        create_dir_all(ports.join("console")).unwrap();
        let none = find_under(&ports, "RIG1").unwrap_err().to_string();
        assert!(none.contains("usb:RIG1") && none.contains("no USB serial port is plugged in"), "{none}");
        plug("1-1", "RIG1", "ttyUSB0");
        plug("1-2", "OTHER", "ttyACM0");
        assert_eq!(find_under(&ports, "RIG1").unwrap(), "ttyUSB0");
        remove_file(ports.join("ttyUSB0/device")).unwrap();
        plug("1-3", "RIG1", "ttyUSB1");
        assert_eq!(find_under(&ports, "RIG1").unwrap(), "ttyUSB1");
        let absent = find_under(&ports, "RIG2").unwrap_err().to_string();
        assert!(absent.contains("there are OTHER (ttyACM0), RIG1 (ttyUSB1)"), "{absent}");
    }
}
