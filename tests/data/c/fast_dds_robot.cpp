// A robot on Fast DDS, the vendor behind the default of ROS 2, that plays with our node.
//
// It writes and reads CDR by hand, so that it shares no code with us: odometry at 50 Hz, twenty
// people at 10 Hz, a path once a second; it follows TwistStamped and brakes when commands stop.
//
//     fast_dds_robot DOMAIN SECONDS OUT
//
// OUT gets a line per command: s, m/s, rad/s, and the speeds that the robot had before.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
typedef std::vector<unsigned char> Bytes;

// Bytes of a type that is known by its name alone.
class Raw : public TopicDataType {
public:
    Raw(const char* name, uint32_t most) {
        setName(name);
        m_typeSize = most;
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        const Bytes& bytes = *static_cast<Bytes*>(data);
        std::memcpy(payload->data, bytes.data(), bytes.size());
        payload->length = static_cast<uint32_t>(bytes.size());
        payload->encapsulation = CDR_LE;
        return true;
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data]() { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes(); }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

// CDR, little-endian.
class Out {
public:
    Bytes bytes{0, 1, 0, 0};
    template <typename T> void put(T value) {
        while ((bytes.size() - 4) % sizeof(T)) bytes.push_back(0);
        const unsigned char* place = reinterpret_cast<const unsigned char*>(&value);
        bytes.insert(bytes.end(), place, place + sizeof(T));
    }
    void text(const char* value) {
        put<uint32_t>(static_cast<uint32_t>(std::strlen(value) + 1));
        bytes.insert(bytes.end(), value, value + std::strlen(value) + 1);
    }
    void header(const char* frame) {
        const auto now = std::chrono::system_clock::now().time_since_epoch();
        const int64_t whole = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
        put<int32_t>(static_cast<int32_t>(whole / 1000000000));
        put<uint32_t>(static_cast<uint32_t>(whole % 1000000000));
        text(frame);
    }
    void numbers(std::initializer_list<double> values) {
        for (double value : values) put<double>(value);
    }
    void zeros(int count) {
        for (int i = 0; i < count; ++i) put<double>(0.0);
    }
};

static double seconds() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch())
        .count();
}

struct Robot {
    double x = 0, y = 0, yaw = 0, speed = 0, rate = 0, heard = -1;

    Bytes odometry() const {
        Out out;
        out.header("odom");
        out.text("base_link");
        out.numbers({x, y, 0, 0, 0, std::sin(yaw / 2), std::cos(yaw / 2)});
        out.zeros(36);
        out.numbers({speed, 0, 0, 0, 0, rate});
        out.zeros(36);
        return out.bytes;
    }
    // Take a command: behind the header stand twelve bytes of stamp and length, then the frame.
    void obey(const Bytes& bytes, FILE* file) {
        if (bytes.size() < 16) return;
        uint32_t length = 0;
        std::memcpy(&length, bytes.data() + 12, 4);
        const size_t place = 4 + (12 + static_cast<size_t>(length) + 7) / 8 * 8;
        if (length > 1000 || bytes.size() < place + 48) return;
        double linear = 0, angular = 0;
        std::memcpy(&linear, bytes.data() + place, 8);
        std::memcpy(&angular, bytes.data() + place + 40, 8);
        heard = seconds();
        std::fprintf(file, "%.6f %.9f %.9f %.9f %.9f\n", heard, linear, angular, speed, rate);
        std::fflush(file);
        speed = linear;
        rate = angular;
    }
    void drive(double dt) {
        if (seconds() - heard > 0.5) {
            speed = std::max(speed - 1.0 * dt, 0.0);
            rate = 0;
        }
        x += dt * speed * std::cos(yaw + 0.5 * dt * rate);
        y += dt * speed * std::sin(yaw + 0.5 * dt * rate);
        yaw += dt * rate;
    }
};

static Bytes people(double now) {
    Out out;
    out.header("odom");
    out.put<uint32_t>(20);
    for (int i = 0; i < 20; ++i) {
        const double side = i % 2 ? 1.0 : -1.0;
        for (int k = 0; k < 16; ++k) out.bytes.push_back(static_cast<unsigned char>(i + 1));
        out.put<float>(1.0f);
        out.numbers({3.0 + 1.5 * i - 0.3 * now, side * (4.0 + 0.1 * i), 0});
        out.numbers({-0.3, 0, 0, 0.6, 0.6, 1.7});
        out.zeros(18);
    }
    return out.bytes;
}

static Bytes path() {
    Out out;
    out.header("odom");
    out.put<uint32_t>(201);
    for (int i = 0; i < 201; ++i) {
        out.header("odom");
        out.numbers({0.5 * i, 0, 0, 0, 0, 0, 1});
    }
    return out.bytes;
}

int main(int count, char** words) {
    if (count != 4) return 2;
    DomainParticipantQos qos;
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    Locator_t peer;
    IPLocator::setIPv4(peer, "127.0.0.1");
    peer.port = 0;
    qos.wire_protocol().builtin.initialPeersList.push_back(peer);
    udp->maxInitialPeersRange = 30;
    auto* node = DomainParticipantFactory::get_instance()->create_participant(
        static_cast<DomainId_t>(std::atoi(words[1])), qos);
    if (!node) return 3;
    const std::vector<std::pair<const char*, const char*>> sent = {
        {"rt/odom", "nav_msgs::msg::dds_::Odometry_"},
        {"rt/obstacles", "nav2_dynamic_msgs::msg::dds_::ObstacleArray_"},
        {"rt/plan", "nav_msgs::msg::dds_::Path_"},
    };
    std::vector<DataWriter*> writers;
    auto* publisher = node->create_publisher(PUBLISHER_QOS_DEFAULT);
    auto* subscriber = node->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    for (const auto& one : sent) {
        TypeSupport type(new Raw(one.second, 65000));
        type.register_type(node);
        auto* topic = node->create_topic(one.first, one.second, TOPIC_QOS_DEFAULT);
        writers.push_back(publisher->create_datawriter(topic, DATAWRITER_QOS_DEFAULT));
    }
    const char* twist = "geometry_msgs::msg::dds_::TwistStamped_";
    TypeSupport type(new Raw(twist, 65000));
    type.register_type(node);
    DataReaderQos reading = DATAREADER_QOS_DEFAULT;
    reading.reliability().kind = RELIABLE_RELIABILITY_QOS;
    reading.history().depth = 10;
    auto* orders = subscriber->create_datareader(
        node->create_topic("rt/cmd_vel", twist, TOPIC_QOS_DEFAULT), reading);
    FILE* file = std::fopen(words[3], "w");
    if (!orders || !file) return 4;

    Robot robot;
    const auto begin = std::chrono::steady_clock::now();
    const int steps = static_cast<int>(std::atof(words[2]) / 0.02);
    for (int i = 0; i < steps; ++i) {
        Bytes told;
        SampleInfo info;
        while (orders->take_next_sample(&told, &info) == ReturnCode_t::RETCODE_OK)
            if (info.valid_data) robot.obey(told, file);
        robot.drive(0.02);
        Bytes said = robot.odometry();
        writers[0]->write(&said);
        if (i % 5 == 0) {
            said = people(0.02 * i);
            writers[1]->write(&said);
        }
        if (i % 50 == 0) {
            said = path();
            writers[2]->write(&said);
        }
        std::this_thread::sleep_until(begin + std::chrono::milliseconds(20 * (i + 1)));
    }
    std::printf("x %.3f y %.3f\n", robot.x, robot.y);
    std::fclose(file);
    return 0;
}
