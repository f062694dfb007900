//! The standard messages of ROS 2 (common_interfaces) that machines record most, for files that leave their definitions
//! out.

/// The definition of `package/Type`.
pub fn definition(name: &str) -> Option<&'static str> {
    Some(match name {
        "builtin_interfaces/Time" => "int32 sec\nuint32 nanosec",
        "builtin_interfaces/Duration" => "int32 sec\nuint32 nanosec",
        "std_msgs/Header" => "builtin_interfaces/Time stamp\nstring frame_id",
        "std_msgs/Bool" => "bool data",
        "std_msgs/Float32" => "float32 data",
        "std_msgs/Float64" => "float64 data",
        "std_msgs/Int8" => "int8 data",
        "std_msgs/Int16" => "int16 data",
        "std_msgs/Int32" => "int32 data",
        "std_msgs/Int64" => "int64 data",
        "std_msgs/UInt8" => "uint8 data",
        "std_msgs/UInt16" => "uint16 data",
        "std_msgs/UInt32" => "uint32 data",
        "std_msgs/UInt64" => "uint64 data",
        "std_msgs/MultiArrayDimension" => "string label\nuint32 size\nuint32 stride",
        "std_msgs/MultiArrayLayout" => "MultiArrayDimension[] dim\nuint32 data_offset",
        "std_msgs/Float32MultiArray" => "MultiArrayLayout layout\nfloat32[] data",
        "std_msgs/Float64MultiArray" => "MultiArrayLayout layout\nfloat64[] data",
        "std_msgs/Int32MultiArray" => "MultiArrayLayout layout\nint32[] data",
        "geometry_msgs/Vector3" => "float64 x\nfloat64 y\nfloat64 z",
        "geometry_msgs/Point" => "float64 x\nfloat64 y\nfloat64 z",
        "geometry_msgs/Quaternion" => "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
        "geometry_msgs/Pose" => "Point position\nQuaternion orientation",
        "geometry_msgs/PoseStamped" => "std_msgs/Header header\nPose pose",
        "geometry_msgs/PoseWithCovariance" => "Pose pose\nfloat64[36] covariance",
        "geometry_msgs/PoseWithCovarianceStamped" => "std_msgs/Header header\nPoseWithCovariance pose",
        "geometry_msgs/Twist" => "Vector3 linear\nVector3 angular",
        "geometry_msgs/TwistStamped" => "std_msgs/Header header\nTwist twist",
        "geometry_msgs/TwistWithCovariance" => "Twist twist\nfloat64[36] covariance",
        "geometry_msgs/TwistWithCovarianceStamped" => "std_msgs/Header header\nTwistWithCovariance twist",
        "geometry_msgs/Accel" => "Vector3 linear\nVector3 angular",
        "geometry_msgs/AccelStamped" => "std_msgs/Header header\nAccel accel",
        "geometry_msgs/AccelWithCovariance" => "Accel accel\nfloat64[36] covariance",
        "geometry_msgs/AccelWithCovarianceStamped" => "std_msgs/Header header\nAccelWithCovariance accel",
        "geometry_msgs/Vector3Stamped" => "std_msgs/Header header\nVector3 vector",
        "geometry_msgs/Wrench" => "Vector3 force\nVector3 torque",
        "geometry_msgs/WrenchStamped" => "std_msgs/Header header\nWrench wrench",
        "geometry_msgs/QuaternionStamped" => "std_msgs/Header header\nQuaternion quaternion",
        "nav_msgs/Odometry" => {
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
             geometry_msgs/TwistWithCovariance twist"
        }
        "sensor_msgs/Imu" => {
            "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
             geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
             geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
        }
        "sensor_msgs/JointState" => {
            "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
        }
        "sensor_msgs/MagneticField" => {
            "std_msgs/Header header\ngeometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance"
        }
        "sensor_msgs/Temperature" => "std_msgs/Header header\nfloat64 temperature\nfloat64 variance",
        "sensor_msgs/Range" => {
            "std_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\nfloat32 max_range\n\
             float32 range\nfloat32 variance"
        }
        "sensor_msgs/NavSatStatus" => "int8 status\nuint16 service",
        "sensor_msgs/NavSatFix" => {
            "std_msgs/Header header\nNavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n\
             float64[9] position_covariance\nuint8 position_covariance_type"
        }
        "ackermann_msgs/AckermannDrive" => {
            "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\nfloat32 jerk"
        }
        "ackermann_msgs/AckermannDriveStamped" => "std_msgs/Header header\nAckermannDrive drive",
        _ => return None,
    })
}
