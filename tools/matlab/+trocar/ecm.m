classdef ecm < trocar.arm
    % An arm with an endoscope: trocar.ecm(), trocar.ecm('ECM'), see trocar.arm.

    methods

        function self = ecm(varargin)
            % ECM unless another name is given; trocar:argument when it is none.
            if nargin == 0, varargin = {'ECM'}; end
            self@trocar.arm(varargin{:});
            self.must_be('ECM');
        end

        function handle = insert_jp(self, depth)
            % Move the insertion (m) alone; the other joints go to their present setpoints.
            jp = self.setpoint_jp();
            jp(3) = depth;
            handle = self.move_jp(jp);
        end

        function name = endoscope(self)
            % The endoscope that it takes itself to carry.
            row = self.state();
            name = row.tool;
        end

        function set_endoscope_type(self, name)
            % Say which endoscope it carries; trocar:refused names those there are.
            self.bridge.command(self.name, 'set_endoscope_type', [], name);
        end

    end

end
